"""Hess & Faller 2000, Table 6: horizontal overshoots of ship 2 (Figs 11, 12), and rivals on the same runs."""

from functools import partial

from studies.hess2000.tables import table_chapter

chapter = partial(table_chapter, "T6")
