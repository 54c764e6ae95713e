"""From a config to what a diagnosis is about: the ship or network, the candidates, the runs."""


DEFAULT, ALL = "default", "all"
