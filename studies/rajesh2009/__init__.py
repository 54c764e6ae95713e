"""Rajesh & Bhattacharyya 2009: each section done again, its numbers and statements beside ours."""
