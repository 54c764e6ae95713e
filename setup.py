"""What pyproject.toml cannot say: in a wheel the folder conf lies in the package, as manoeuvre_nn/conf."""

from setuptools import find_namespace_packages, setup

CONF = "manoeuvre_nn.conf"

# All folders, those that hold no code included: setuptools warns of data in what is not named.
setup(
    packages=[*find_namespace_packages("src"), CONF, *(f"{CONF}.{group}" for group in find_namespace_packages("conf"))],
    package_dir={"": "src", CONF: "conf"},
)
