"""Train and judge neural models of ship manoeuvring."""

__version__ = "0.1.0"
