"""Cepowski 2007, "Approximation of pitching motion of S-175 containership in irregular waves", done again."""
