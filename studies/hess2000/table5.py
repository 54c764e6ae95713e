"""Hess & Faller 2000, Table 5: tactical circles of ship 2 (Figs 7, 9 and 10)."""

from functools import partial

from studies.hess2000.tables import table_chapter

chapter = partial(table_chapter, "T5")
