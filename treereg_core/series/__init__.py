"""A series of surveys of one orchard: all registered onto the first, and every tree followed through them.

`register_series` does it; `History` says what each survey shows of each tree.
"""

from treereg_core.series.history import History, State
from treereg_core.series.registering import Member, Series, register_series

__all__ = ["History", "Member", "Series", "State", "register_series"]
