"""Hess & Faller 2000, Table 4: tactical circles of ship 1 (Fig. 8), and rivals on the same runs."""

from functools import partial

from studies.hess2000.tables import table_chapter

chapter = partial(table_chapter, "T4")
