"""The page in a real browser, Meta's emulator as the headset: poses and order, never timing."""

import time

import numpy as np
import pytest

from vrbench.devices.link import FUTURE_NS


def record(headset, page, seconds=1.0):
    headset.start("replay.default.m1.r1")
    page.wait_for_timeout(1000 * seconds)
    headset.stop()
    return headset.read()


def until(page, condition):
    """Waits while the browser's own events go on."""
    for _ in range(500):
        if condition():
            return
        page.wait_for_timeout(20)
    raise AssertionError("what was waited for did not come")


def begin(headset, page):
    page.get_by_role("button", name="Start").click()
    until(page, lambda: headset.missing is None)


def compare(page, samples):
    """The largest difference of samples from the poses injected, which are numbered by frame."""
    count = page.evaluate("INJECTED.frames()")
    injected = np.array(
        page.evaluate(f"Array.from({{length: {count}}}, (_, k) => INJECTED.path(k))")
    )
    first = np.argmin(np.abs(injected[:, :3] - samples.pose.p[0]).sum(axis=1))
    meant = injected[first : first + len(samples)]
    assert len(meant) == len(samples)
    signs = np.sign(np.sum(samples.pose.q * meant[:, 3:], axis=1))[:, None]
    return (
        np.abs(samples.pose.p - meant[:, :3]).max(),
        np.abs(samples.pose.q * signs - meant[:, 3:]).max(),
    )


@pytest.mark.parametrize(
    ("device", "rate_hz"), [("metaQuest2", 72), ("metaQuestPro", 90), ("metaQuest3", 120)]
)
def test_poses_are_those_injected_and_no_frame_is_missing(headset, open_page, device, rate_hz):
    page = open_page(headset.url, device, rate_hz)
    begin(headset, page)
    columns = record(headset, page)
    samples = columns.poses["headset/eye"]
    assert len(samples) > 10
    assert samples.good.all(), columns.events
    p_error, q_error = compare(page, samples)
    assert p_error < 1e-6
    assert q_error < 1e-6
    assert not [event for event in columns.events if event.detail.get("kind") == "sequence"]
    assert np.all(np.diff(samples.pose_t) > 0)
    # a frame isn't made after it arrives, as far as the clock is known
    assert np.all(samples.pose_t <= samples.receive_t + FUTURE_NS)
    assert len(columns.clocks["headset"]) > 5
    (facts,) = [event.detail for event in columns.events if event.kind == "headset"]
    assert facts["isolated"] is True
    assert {"local", "local-floor"} <= set(facts["features"])
    assert "Quest" in facts["agent"]
    assert page.problems == []


def test_one_session_lives_through_many_takes(headset, open_page):
    page = open_page(headset.url, "metaQuest3")
    begin(headset, page)
    epochs = set()
    for _ in range(3):
        headset.start("take")
        page.wait_for_selector("text=Recording")
        headset.stop()
        columns = headset.read()
        epochs |= set(columns.poses["headset/eye"].epoch.tolist())
        page.wait_for_selector("text=Running")
        assert headset.read().poses == {}
    assert epochs == {0}


def test_a_connection_that_breaks_loses_no_frame(headset, open_page):
    page = open_page(headset.url, "metaQuest2")
    begin(headset, page)
    headset.start("take")
    page.wait_for_timeout(300)
    page.evaluate("socket.close()")
    page.wait_for_timeout(100)
    until(page, lambda: headset.missing is None)
    page.wait_for_timeout(300)
    headset.stop()
    columns = headset.read()
    samples = columns.poses["headset/eye"]
    assert samples.good.all()
    assert max(compare(page, samples)) < 1e-6
    states = [event.detail["state"] for event in columns.events if event.kind == "connection"]
    assert states == ["lost", "open"]
    assert set(samples.epoch.tolist()) == {0}


def test_a_connection_that_falls_silent_is_made_anew_and_loses_no_frame(
    headset, open_page, relayed
):
    relay = relayed(headset.server.port)
    page = open_page(headset.url.replace(str(headset.server.port), str(relay.port)), "metaQuest2")
    begin(headset, page)
    headset.start("take")
    page.wait_for_timeout(300)
    relay.swallow()  # what is under way is lost, and nobody hears that the connection is gone
    page.wait_for_selector("text=Recorder lost")
    page.wait_for_selector("text=Recording")
    until(page, lambda: headset.missing is None)
    page.wait_for_timeout(300)
    headset.stop()
    columns = headset.read()
    samples = columns.poses["headset/eye"]
    assert samples.good.all()
    assert max(compare(page, samples)) < 1e-6
    assert not [event for event in columns.events if event.detail.get("kind") == "sequence"]


def test_what_the_recorder_cannot_read_is_given_up_and_the_rest_goes_on(headset, open_page):
    page = open_page(headset.url, "metaQuest3")
    begin(headset, page)
    headset.start("take")
    page.wait_for_timeout(300)
    page.evaluate("hold((row) => row.fill(NaN))")
    page.wait_for_selector("text=not understood: a frame without its times")
    until(page, lambda: headset.missing is None)
    page.wait_for_timeout(300)
    headset.stop()
    columns = headset.read()
    (gap,) = [event.detail for event in columns.events if event.detail.get("kind") == "sequence"]
    assert gap["missing"] >= 1
    assert [event for event in columns.events if event.kind == "refused"]
    samples = columns.poses["headset/eye"]
    assert samples.good[-10:].all()
    page.wait_for_selector("text=Running")


def test_who_was_refused_for_another_headset_gets_in_once_that_has_gone(headset, open_page):
    first = open_page(headset.url, "metaQuest3")
    begin(headset, first)
    second = open_page(headset.url, "metaQuest3")
    second.wait_for_selector("text=another headset is connected")
    first.close()
    second.wait_for_selector("text=Ready")
    assert second.get_by_role("button", name="Start").is_enabled()


def test_a_recentre_starts_an_epoch_and_a_new_session_another(headset, open_page):
    page = open_page(headset.url, "metaQuest3")
    begin(headset, page)
    headset.start("take")
    page.wait_for_timeout(300)
    page.evaluate("INJECTED.device.recenter()")
    page.wait_for_selector("text=once")
    page.wait_for_timeout(300)
    page.get_by_role("button", name="End session").dispatch_event("click")
    page.wait_for_selector("text=Ready")
    page.get_by_role("button", name="Start").click()
    until(page, lambda: headset.missing is None)
    page.wait_for_timeout(300)
    headset.stop()
    columns = headset.read()
    kinds = [event.kind for event in columns.events]
    assert {"reset", "session-end", "session-start", "recentre"} <= set(kinds)
    epochs = columns.poses["headset/eye"].epoch
    assert sorted(set(epochs.tolist())) == [0, 1, 2]
    assert np.all(np.diff(epochs.astype(int)) >= 0)


def test_a_hidden_session_is_told(headset, open_page):
    page = open_page(headset.url, "metaQuest3")
    begin(headset, page)
    headset.start("take")
    page.wait_for_timeout(200)
    page.evaluate("INJECTED.device.updateVisibilityState('hidden')")
    page.wait_for_selector("text=Session hidden")
    page.wait_for_timeout(100)
    page.evaluate("INJECTED.device.updateVisibilityState('visible')")
    page.wait_for_selector("text=Recording")
    headset.stop()
    columns = headset.read()
    events = columns.events
    states = [event.detail["state"] for event in events if event.kind == "visibility"]
    assert states == ["hidden", "visible"]
    # the emulator goes on with frames, which a headset doesn't
    assert set(columns.poses["headset/eye"].flags.tolist()) == {3, 15}


# Every third pose is missing, every third has an emulated position, and has velocities.
UNTRACKED = """
(() => {
  const get = XRFrame.prototype.getViewerPose;
  let k = -1;
  XRFrame.prototype.getViewerPose = function (space) {
    const pose = get.call(this, space);
    k += 1;
    if (k % 3 === 1) return null;
    if (k % 3 === 2) {
      return {transform: pose.transform, views: pose.views, emulatedPosition: true,
              linearVelocity: {x: 1, y: 2, z: 3}, angularVelocity: null};
    }
    return pose;
  };
  Object.defineProperty(XRFrame.prototype, "predictedDisplayTime",
    {get() { return performance.now() + 30; }});
})();
"""


def test_poses_that_are_missing_or_emulated_are_no_good_ones(headset, open_page):
    page = open_page(headset.url, "metaQuest3", script=UNTRACKED)
    begin(headset, page)
    columns = record(headset, page, 0.5)
    samples, frames = columns.poses["headset/eye"], columns.joints["headset/frames"]
    assert set(samples.flags.tolist()) == {0, 7, 15}
    order = [15, 0, 7]
    first = order.index(samples.flags[0])
    assert samples.flags.tolist() == [order[(first + i) % 3] for i in range(len(samples))]
    velocity = frames.position[:, 3:6]
    np.testing.assert_array_equal(np.isfinite(velocity).all(axis=1), samples.flags == 7)
    np.testing.assert_allclose(
        velocity[samples.flags == 7], [[1, 2, 3]] * (samples.flags == 7).sum()
    )
    ahead = (samples.pose_t - samples.source_t) - (frames.t - samples.source_t)
    assert np.all(ahead > 29e6)
    assert samples.good.sum() == (samples.flags == 15).sum()


def test_a_browser_without_a_headset_says_so_on_both_sides(headset, open_page):
    page = open_page(headset.url)
    page.wait_for_selector("text=No WebXR here")
    page.wait_for_selector("text=Open this address in the headset's own browser")
    assert page.get_by_role("button", name="Start").is_disabled()
    until(page, lambda: headset.server.hello is not None)
    what, fix = headset.missing
    assert what.startswith("this browser has no WebXR")
    assert headset.url in fix


@pytest.mark.parametrize("width", [320, 390, 1280])
def test_the_page_fits_any_screen(headset, open_page, width):
    page = open_page(headset.url, "metaQuest3")
    page.set_viewport_size({"width": width, "height": 700})
    begin(headset, page)
    page.wait_for_selector("text=Running")
    assert page.evaluate("document.documentElement.scrollWidth") == width


def test_the_page_works_by_https_with_our_own_certificate(
    serving, open_page, tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with serving(tls=True) as headset:
        assert headset.url.startswith("https://")
        page = open_page(headset.url, "metaQuestPro")
        assert page.evaluate("isSecureContext && crossOriginIsolated")
        begin(headset, page)
        samples = record(headset, page, 0.3).poses["headset/eye"]
        assert max(compare(page, samples)) < 1e-6


def test_a_second_headset_is_told_that_there_is_one(headset, open_page):
    first = open_page(headset.url, "metaQuest3")
    begin(headset, first)
    second = open_page(headset.url, "metaQuest3")
    second.wait_for_selector("text=another headset is connected")
    assert headset.missing is None


def test_a_page_of_another_origin_is_refused(headset, serving, open_page):
    with serving() as other:
        page = open_page(other.url, "metaQuest3")
        until(page, lambda: other.server.hello is not None)
        address = headset.url.replace("http", "ws") + "ws"
        # our policy forbids the page even to try; a page of another site has another policy
        outcome = page.evaluate(
            """(address) => new Promise((done) => {
              try {
                const socket = new WebSocket(address);
                socket.onopen = () => done("open");
                socket.onerror = () => done("refused");
              } catch (error) { done("refused"); }
            })""",
            address,
        )
        assert outcome == "refused"
    time.sleep(0.05)
    assert headset.server.hello is None
