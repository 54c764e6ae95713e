"""The concealed trial: a referee with equations of its own draws cases, conceals their answers and scores tools."""
