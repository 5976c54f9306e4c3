"""A bandwidth that no craft has is none."""

from sysid.frequency.closed_loop import _possible
from sysid.statistics.parameter import Parameter


def test_a_yaw_that_follows_its_own_heading_has_no_bandwidth():
    """On a real flight the halves said 24 and 89 rad/s: the target of yaw was the heading while nobody turned."""
    found = _possible(Parameter(89.0, 8.6, "rad/s"), "yaw")
    assert found.value is None
    assert "follows the heading" in found.reason
    assert _possible(Parameter(8.0, 0.5, "rad/s"), "yaw").value == 8.0
    assert _possible(Parameter(60.0, 3.0, "rad/s"), "roll").value == 60.0
