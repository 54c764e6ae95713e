"""What pyproject.toml cannot say: in a wheel the folder conf lies in the package, as manoeuvre_nn/conf."""

from setuptools import find_packages, setup

setup(
    packages=[*find_packages("src"), "manoeuvre_nn.conf"],
    package_dir={"": "src", "manoeuvre_nn.conf": "conf"},
)
