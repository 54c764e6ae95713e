"""Studies done with the package and kept outside it: two papers done again, and a concealed trial."""
