"""What every headset plugin passes; the route on a made-up runtime."""

from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from vrbench.plugin.testing import HeadsetConformance, HeadsetModelConformance

MODELS = ("index", "vive", "varjo", "wmr", "psvr2", "monado")


class TestRoute(HeadsetConformance):
    name = "openxr"

    @pytest.fixture(autouse=True, scope="class")
    @classmethod
    def _made_up(cls, make_runtime):
        cls.make_runtime = staticmethod(make_runtime)

    @classmethod
    @contextmanager
    def stand_in(cls, rehearsal):
        """The runtime of the tests, on a head that moves as it is rehearsed."""
        runtime = cls.make_runtime()
        xr, shown = runtime.xr, []

        def locate(space, base, xr_time):
            m = shown.pop()
            pose = xr.Posef(xr.Quaternionf(*m.q), xr.Vector3f(*m.p))
            flags = xr.SpaceLocationFlags(15 if m.tracked else 0)
            return SimpleNamespace(pose=pose, location_flags=flags)

        def poll(instance):
            # asked before every pose: what the runtime tells of then is true of it
            if not runtime.events and not shown:
                shown.append(rehearsal.moment(rehearsal.now()))
                if shown[0].epoch != told["epoch"]:
                    told["epoch"] = shown[0].epoch
                    runtime.recentre(0)
            return polled(instance)

        told = {"epoch": rehearsal.moment(rehearsal.now()).epoch}
        module = runtime.module()
        polled, module.poll_event, module.locate_space = module.poll_event, poll, locate
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("vrbench_openxr.runtime.load", lambda: module)
            yield {"rate_hz": rehearsal.rate_hz}


@pytest.mark.parametrize("name", MODELS)
def test_every_model_passes(name):
    class Model(HeadsetModelConformance):
        pass

    Model.name = name
    assert [x for x in Model.run() if x.status != "passed"] == []
