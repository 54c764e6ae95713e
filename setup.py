"""What pyproject.toml cannot say: in a wheel the folder conf lies in the package, as manoeuvre_nn/conf."""

from setuptools import find_namespace_packages, setup

CONF = "manoeuvre_nn.conf"


def folders(place: str) -> list[str]:
    """All folders of a place, those that hold no code included: setuptools warns of data in what is not named."""
    return find_namespace_packages(place, exclude=["*__pycache__*"])


setup(
    packages=[*folders("src"), CONF, *(f"{CONF}.{group}" for group in folders("conf"))],
    package_dir={"": "src", CONF: "conf"},
)
