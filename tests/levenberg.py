"""Levenberg-Marquardt with flat options, as tests write them."""

from dataclasses import fields

from manoeuvre_nn.numerics.damping import Damping, Stops
from manoeuvre_nn.numerics.levenberg_marquardt import LevenbergMarquardt


def split(**options) -> dict:
    """Options of the damping (``damping`` is its rule) and of the stops, and the others as they are."""
    if "damping" in options:
        options["rule"] = options.pop("damping")
    damping = {f.name: options.pop(f.name) for f in fields(Damping) if f.name in options}
    stops = {f.name: options.pop(f.name) for f in fields(Stops) if f.name in options}
    return {"damping": Damping(**damping), "stops": Stops(**{"min_step": 0.0} | stops), **options}


def lm(parameters, **options) -> LevenbergMarquardt:
    return LevenbergMarquardt(parameters, **split(**{"min_grad": 1e-7} | options))
