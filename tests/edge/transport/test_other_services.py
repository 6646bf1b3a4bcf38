"""Which other services judge the same site."""

from edge.codec.messages import KEYS
from sim.clock import FakeClock
from structlog.testing import capture_logs

from headway.edge.transport.other_services import OtherServices


def test_a_service_is_named_once_and_forgotten_when_it_reports_no_more() -> None:
    clock = FakeClock()
    others = OtherServices(KEYS, clock)
    with capture_logs() as logs:
        for _ in range(3):
            others.report(KEYS.health("rsu-2"))
            clock.sleep(20.0)
        others.report("v2x/elsewhere/health/rsu-3")
        others.report(KEYS.health("rsu-2"))
    assert [line["other"] for line in logs] == ["rsu-2"]
    assert others.instances == ("rsu-2",)
    clock.sleep(31.0)
    assert others.instances == ()
