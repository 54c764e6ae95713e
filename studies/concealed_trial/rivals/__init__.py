"""Rival methods: two other ways to name what a calm-water model lacks, on the same cases."""
