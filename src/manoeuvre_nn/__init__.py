"""Models of ship manoeuvring from simulated or measured runs: read, simulate, fit, score, diagnose, export."""

__version__ = "0.1.0"
__all__ = ["diagnose", "export", "fit", "read", "score", "simulate"]

TYPE_CHECKING = False
if TYPE_CHECKING:
    from manoeuvre_nn.api import diagnose, export, fit, read, score, simulate


def __getattr__(name: str) -> object:
    """The front door, loaded when it is first used: torch and lightning take seconds."""
    if name not in {*__all__, "api"}:
        raise AttributeError(f"module manoeuvre_nn has no attribute {name}")
    from importlib import import_module

    door = import_module("manoeuvre_nn.api")
    return door if name == "api" else getattr(door, name)


def __dir__() -> list[str]:
    """What a person may use."""
    return [*__all__, "__version__"]
