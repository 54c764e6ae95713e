"""Hess & Faller 2000, "Simulation of ship maneuvers using recursive neural networks", done again."""
