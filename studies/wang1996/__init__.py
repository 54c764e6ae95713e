"""Wang 1996, the thesis: each chapter done again, its numbers and statements beside ours."""
