from collections.abc import Callable

import numpy as np
import pytest

from manoeuvre_nn.core.recording import Recording

LENGTH = 100.0


def course(
    name: str = "zz20", drift: float = 0.0, status: str = "ok", end: float = 200.0, kind: str = "zigzag"
) -> Recording:
    """10 m/s to the north; the track is ``drift`` m/s off to the east, heading and rudder swing by 20 deg."""
    time = np.arange(0.0, end + 0.5)
    swing = np.deg2rad(20) * np.sin(time / 20)
    channels = {"u": 10 + 0.1 * swing, "v": 0.3 * swing, "r": np.deg2rad(1) * np.cos(time / 20), "psi": swing}
    channels |= {"x": 10 * time, "y": drift * time, "delta": -swing}
    return Recording(name, time, channels, status, {"kind": kind, "length": LENGTH})


def spiral_of_steps() -> Recording:
    """Rudder held for 10 s each at 20, 10, 0, -10, -20 deg; yaw rate 1/20 of the rudder when each hold ends."""
    time = np.arange(50.0)
    order = np.deg2rad(20 - 10 * (time // 10))
    r = order / 20 * ((time % 10) / 9)
    channels = {name: np.zeros(50) for name in ("u", "v", "x", "y", "psi")}
    return Recording(
        "spiral20",
        time,
        {**channels, "r": r, "delta": order, "delta_order": order},
        "ok",
        {"kind": "spiral", "length": LENGTH},
    )


@pytest.fixture
def recorded() -> Recording:
    return course()


@pytest.fixture
def make_course() -> Callable[..., Recording]:
    return course


@pytest.fixture
def spiral() -> Recording:
    return spiral_of_steps()
