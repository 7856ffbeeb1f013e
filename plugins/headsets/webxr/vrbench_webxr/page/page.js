// The page of vrbench-webxr: every frame's pose goes to the recorder, and none is lost on the way.
// What is said over the socket, and when, is in PROTOCOL.md.
"use strict";

const VERSION = 1;
const COLUMNS = 18;
const HEADER = 4;
const MAX_ROWS = 4096;
// Frames held while the recorder is away: nine minutes at 120 Hz.
const CAPACITY = 65536;
const ORIENTATION_VALID = 1, POSITION_VALID = 2, ORIENTATION_TRACKED = 4, POSITION_TRACKED = 8;
const SECOND_CLIENT = 4001, BAD_MESSAGE = 4002, OTHER_VERSION = 4003;
// The recorder asks for the time ten times a second. Where it stays silent for so long, the
// connection is gone, though nobody said so: another network, a PC asleep.
const SILENT_MS = 3000;
const OPTIONAL_FEATURES = ["local-floor", "unbounded"];

const byId = (id) => document.getElementById(id);
const randomName = () =>
  Array.from(crypto.getRandomValues(new Uint8Array(16)), (b) => b.toString(16).padStart(2, "0")).join("");

// ---- Frames and events that the recorder has not acknowledged yet ----

const ring = new Float64Array(CAPACITY * COLUMNS);
const frames = { first: 0, next: 0, sent: 0, dropped: 0 };

function hold(fill) {
  if (frames.next - frames.first === CAPACITY) {
    frames.first += 1; // the oldest is lost; the recorder sees the gap in the numbers
    frames.dropped += 1;
  }
  const at = (frames.next % CAPACITY) * COLUMNS;
  fill(ring.subarray(at, at + COLUMNS));
  frames.next += 1;
}

function sendFrames() {
  frames.sent = Math.max(frames.sent, frames.first);
  while (frames.sent < frames.next) {
    const place = frames.sent % CAPACITY;
    const count = Math.min(frames.next - frames.sent, MAX_ROWS, CAPACITY - place);
    const batch = new Float64Array(HEADER + count * COLUMNS);
    batch.set([VERSION, frames.sent, count, COLUMNS]);
    batch.set(ring.subarray(place * COLUMNS, (place + count) * COLUMNS), HEADER);
    socket.send(batch);
    frames.sent += count;
  }
}

const events = { waiting: [], next: 0, sent: 0 };

function tell(kind, detail = {}) {
  events.waiting.push({ type: "event", id: events.next, kind, now_ms: performance.now(), detail });
  events.next += 1;
  if (events.waiting.length > 1000) events.waiting.shift();
}

function sendEvents() {
  for (const event of events.waiting) {
    if (event.id >= events.sent) say(event);
  }
  events.sent = events.next;
}

// What the recorder can't read it never will: the rest goes on without it.
function giveUpSent() {
  const refused = frames.sent - frames.first;
  if (refused > 0) {
    frames.first = frames.sent;
    frames.dropped += refused;
  }
  while (events.waiting.length && events.waiting[0].id < events.sent) events.waiting.shift();
}

function acknowledge(nextFrame, lastEvent) {
  if (nextFrame !== null) frames.first = Math.max(frames.first, Math.min(nextFrame, frames.next));
  while (events.waiting.length && events.waiting[0].id <= lastEvent) events.waiting.shift();
}

// ---- The socket ----

const page = randomName();
let socket = null;
let wantedRate = null;
let take = null;
let refused = "";
let retryMs = 250;
let heardAt = 0;

const say = (message) => socket.send(JSON.stringify(message));
const isOpen = () => socket !== null && socket.readyState === WebSocket.OPEN && socket.welcome === true;

function connect() {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  const opened = new WebSocket(`${scheme}//${location.host}${location.pathname}ws`);
  opened.binaryType = "arraybuffer";
  socket = opened;
  heardAt = performance.now();
  opened.onopen = () => {
    if (opened !== socket) return;
    say({
      type: "hello", protocol: VERSION, page, origin_ms: performance.timeOrigin, client: "page",
      agent: navigator.userAgent.slice(0, 500), isolated: self.crossOriginIsolated === true,
      webxr: support.works, reason: support.reason.slice(0, 300),
    });
  };
  opened.onmessage = (event) => {
    if (opened !== socket) return;
    const received = performance.now();
    heardAt = received;
    receive(JSON.parse(event.data), received);
  };
  opened.onclose = (event) => {
    if (opened === socket) connectionLost(event.code, event.reason);
  };
}

function connectionLost(code, reason) {
  const known = socket.welcome === true;
  socket = null;
  if (known) note("recorder lost");
  if (known && code === BAD_MESSAGE) {
    giveUpSent();
    note(`not understood: ${reason}`);
  }
  refused = code === SECOND_CLIENT || code === OTHER_VERSION || (code === BAD_MESSAGE && !known)
    ? reason || `code ${code}` : "";
  retryMs = refused ? 3000 : Math.min(retryMs * 1.5, 2000);
  setTimeout(connect, retryMs);
  show();
}

function lookWhetherHeard() {
  if (socket === null || Math.abs(performance.now() - heardAt) < SILENT_MS) return;
  const silent = socket;
  connectionLost(1006, "silent");
  silent.close();
}

function receive(message, received) {
  switch (message.type) {
    case "ping":
      // Frames and events made before the answer go before it: the recorder counts on that.
      acknowledge(message.next, message.event);
      sendFrames();
      sendEvents();
      say({ type: "pong", id: message.id, received_ms: received, sent_ms: performance.now() });
      break;
    case "welcome":
      socket.welcome = true;
      refused = "";
      retryMs = 250;
      wantedRate = message.rate_hz;
      take = message.take;
      if (message.next !== null) acknowledge(message.next, -1);
      frames.sent = frames.first;
      events.sent = 0;
      note("recorder found");
      sayState();
      show();
      break;
    case "take":
      take = message.name;
      note(take === null ? "take ended" : `take ${take}`);
      show();
      break;
  }
}

// ---- The session ----

const support = { known: false, works: false, reason: "", advice: "" };
const xr = {
  session: null, space: null, gl: null, epoch: 0, started: 0, visibility: "", features: [],
  rateHz: null, view: null, last: null, resets: 0, display: "–",
};
const recent = { frames: 0, tracked: 0, since: performance.now(), rate: null, part: null };

async function lookAtSupport() {
  if (!window.isSecureContext) {
    support.reason = "the page is not from a secure address";
    support.advice = "Open it by https://, or by http://localhost after adb reverse, as the PC printed it.";
  } else if (!navigator.xr) {
    support.reason = "it does not know WebXR";
    support.advice = "Open this address in the headset's own browser; on a PC, in Chrome or Edge.";
  } else if (!(await navigator.xr.isSessionSupported("immersive-vr").catch(() => false))) {
    support.reason = "it has no headset, or may not use it";
    support.advice = "Open this address in the headset's own browser. On a PC: start the headset's"
      + " runtime, then load this page anew.";
  } else {
    support.works = true;
  }
  support.known = true;
}

async function start() {
  byId("start").disabled = true;
  try {
    const session = await navigator.xr.requestSession("immersive-vr", {
      requiredFeatures: ["local"], optionalFeatures: OPTIONAL_FEATURES,
    });
    // before anything that can fail: an end has to be seen
    session.addEventListener("end", () => ended(session));
    try {
      await begin(session);
    } catch (error) {
      await session.end().catch(() => {});
      throw error;
    }
  } catch (error) {
    note(`no session: ${error.message || error.name}`);
  }
  show();
}

async function begin(session) {
  const gl = byId("canvas").getContext("webgl", { xrCompatible: true, antialias: false, depth: false });
  if (gl === null) throw new Error("WebGL is off");
  if (gl.makeXRCompatible) await gl.makeXRCompatible();
  session.updateRenderState({ baseLayer: new XRWebGLLayer(session, gl, { antialias: false }) });
  const space = await session.requestReferenceSpace("local");
  const granted = session.enabledFeatures ? Array.from(session.enabledFeatures) : ["local"];
  space.addEventListener("reset", (event) => {
    xr.epoch += 1;
    xr.resets += 1;
    tell("reset", { epoch: xr.epoch, moved: event.transform ? String(placeOf(event.transform)) : null });
    note("recentred");
  });
  session.addEventListener("visibilitychange", () => {
    xr.visibility = session.visibilityState;
    tell("visibility", { state: session.visibilityState });
    note(`session ${session.visibilityState}`);
    sayState();
    show();
  });
  session.addEventListener("frameratechange", () => {
    xr.rateHz = session.frameRate ?? null;
    tell("rate", { hz: xr.rateHz });
  });
  xr.epoch = xr.started; // a new session has a new origin
  xr.started = xr.epoch + 1;
  Object.assign(xr, { session, space, gl, features: granted, view: null, last: null });
  xr.visibility = session.visibilityState;
  await askForRate(session);
  xr.rateHz = session.frameRate ?? null;
  tell("session-start", { epoch: xr.epoch, features: granted.join(" "), mode: "immersive-vr" });
  note("session started");
  session.requestAnimationFrame(onFrame);
  sayState();
}

async function askForRate(session) {
  if (!wantedRate || !session.updateTargetFrameRate) return;
  try {
    await session.updateTargetFrameRate(wantedRate);
  } catch (error) {
    const rates = Array.from(session.supportedFrameRates ?? []).join(", ");
    tell("note", { what: `rate ${wantedRate} Hz refused`, supported: rates });
    note(`${wantedRate} Hz refused; there are ${rates}`);
  }
}

function ended(session) {
  if (xr.session !== session) return;
  xr.session = null;
  xr.started = xr.epoch + 1;
  tell("session-end", { epoch: xr.epoch });
  note("session ended");
  sayState();
  show();
}

function onFrame(time, frame) {
  const now = performance.now();
  const session = frame.session;
  session.requestAnimationFrame(onFrame);
  const pose = frame.getViewerPose(xr.space);
  const display = frame.predictedDisplayTime;
  let flags = 0;
  hold((row) => {
    row.fill(NaN);
    row[0] = time;
    if (typeof display === "number") row[1] = display;
    row[2] = now;
    if (pose) {
      const { position: p, orientation: q } = pose.transform;
      row[3] = p.x; row[4] = p.y; row[5] = p.z;
      row[6] = q.x; row[7] = q.y; row[8] = q.z; row[9] = q.w;
      const v = pose.linearVelocity, w = pose.angularVelocity;
      if (v) { row[10] = v.x; row[11] = v.y; row[12] = v.z; }
      if (w) { row[13] = w.x; row[14] = w.y; row[15] = w.z; }
      flags = ORIENTATION_VALID | POSITION_VALID;
      // a hidden session should have no frames; what a browser gives all the same is not believed
      if (session.visibilityState !== "hidden") {
        flags |= ORIENTATION_TRACKED;
        if (!pose.emulatedPosition) flags |= POSITION_TRACKED;
      }
    }
    row[16] = flags;
    row[17] = xr.epoch;
  });
  xr.last = pose ? pose.transform.position : null;
  xr.display = typeof display !== "number" ? "not given" : `${Math.round(display - now)} ms ahead`;
  if (pose && xr.view === null && pose.views.length) {
    // where the first eye stands in the viewer, once: the pose itself is the head's centre
    xr.view = placeOf(pose.transform.inverse, pose.views[0].transform);
  }
  recent.frames += 1;
  if (flags & POSITION_TRACKED) recent.tracked += 1;
  const layer = session.renderState.baseLayer;
  if (layer) {
    xr.gl.bindFramebuffer(xr.gl.FRAMEBUFFER, layer.framebuffer);
    xr.gl.clearColor(0.05, 0.08, 0.1, 1);
    xr.gl.clear(xr.gl.COLOR_BUFFER_BIT);
  }
}

// Seven numbers x y z qx qy qz qw of a transform, or of a second one seen from the first.
function placeOf(first, second) {
  const { position: p, orientation: q } = first;
  if (!second) return [p.x, p.y, p.z, q.x, q.y, q.z, q.w];
  const { position: s, orientation: r } = second;
  const tx = 2 * (q.y * s.z - q.z * s.y), ty = 2 * (q.z * s.x - q.x * s.z), tz = 2 * (q.x * s.y - q.y * s.x);
  return [
    p.x + s.x + q.w * tx + q.y * tz - q.z * ty,
    p.y + s.y + q.w * ty + q.z * tx - q.x * tz,
    p.z + s.z + q.w * tz + q.x * ty - q.y * tx,
    q.w * r.x + q.x * r.w + q.y * r.z - q.z * r.y,
    q.w * r.y - q.x * r.z + q.y * r.w + q.z * r.x,
    q.w * r.z + q.x * r.y - q.y * r.x + q.z * r.w,
    q.w * r.w - q.x * r.x - q.y * r.y - q.z * r.z,
  ];
}

// ---- What a person sees ----

function sayState() {
  if (!isOpen()) return;
  say({
    type: "state", session: xr.session !== null, mode: "immersive-vr", space: "local",
    visibility: xr.visibility, features: xr.features, rate_hz: xr.rateHz || null, view: xr.view,
    held: frames.next - frames.first, dropped: frames.dropped,
  });
}

function stateOf() {
  if (support.known && !support.works) {
    return ["unsupported", "No WebXR here", `This browser can't do it: ${support.reason}. ${support.advice}`];
  }
  if (refused) return ["refused", "Not connected", `The recorder refused: ${refused}.`];
  if (xr.session && xr.visibility === "hidden") {
    return ["paused", "Session hidden", "Close the menu: the headset gives no frames meanwhile."];
  }
  if (!isOpen()) {
    return xr.session
      ? ["lost", "Recorder lost", "Frames are kept and sent when it is back."]
      : ["connecting", "Connecting", "Looking for the recorder on the PC."];
  }
  if (!xr.session) return ["ready", "Ready", "Press Start, then mount the headset. The PC does the rest."];
  if (take !== null) return ["recording", "Recording", take];
  return ["running", "Running", "Mount the headset now. Takes are started and stopped from the PC."];
}

function show() {
  const [state, headline, hint] = stateOf();
  document.body.dataset.state = state;
  byId("headline").textContent = headline;
  byId("hint").textContent = hint;
  byId("link").dataset.open = String(isOpen());
  byId("link-text").textContent = isOpen() ? "recorder connected" : "no recorder";
  byId("start").disabled = !support.works || xr.session !== null || refused !== "";
  byId("start").hidden = xr.session !== null;
  byId("end").hidden = xr.session === null;
  byId("rate").textContent = recent.rate === null ? "–" : recent.rate.toFixed(1);
  byId("tracked").textContent = recent.part === null ? "–" : Math.floor(100 * recent.part);
  byId("sent").textContent = grouped(frames.first - frames.dropped);
  byId("held").textContent = grouped(frames.next - frames.first) + (frames.dropped ? `, ${frames.dropped} lost` : "");
  byId("session").textContent = xr.session ? `immersive-vr, local, ${xr.visibility}` : "none";
  byId("granted").textContent = xr.session ? xr.features.join(" ") : "–";
  byId("position").textContent = xr.last
    ? [xr.last.x, xr.last.y, xr.last.z].map((x) => x.toFixed(3)).join("  ") + " m" : "–";
  byId("recentred").textContent = xr.resets === 0 ? "never" : xr.resets === 1 ? "once" : `${xr.resets} times`;
  byId("display").textContent = xr.session ? xr.display : "–";
  byId("timer").textContent = self.crossOriginIsolated ? "fine, isolated" : "coarse, 0.1 ms";
}

const grouped = (n) => String(n).replace(/\B(?=(\d{3})+$)/g, "\u2009");

function note(text) {
  const line = document.createElement("li");
  line.textContent = `${new Date().toTimeString().slice(0, 8)}  ${text}`;
  const log = byId("log");
  log.prepend(line);
  while (log.children.length > 6) log.lastChild.remove();
}

function everySecond() {
  const now = performance.now();
  const seconds = (now - recent.since) / 1000;
  recent.rate = xr.session ? recent.frames / seconds : null;
  recent.part = recent.frames ? recent.tracked / recent.frames : null;
  Object.assign(recent, { frames: 0, tracked: 0, since: now });
  lookWhetherHeard();
  sayState();
  show();
}

byId("start").addEventListener("click", start);
byId("end").addEventListener("click", () => xr.session && xr.session.end());
lookAtSupport().then(() => {
  connect();
  show();
});
setInterval(everySecond, 1000);
show();
