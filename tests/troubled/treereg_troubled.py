"""A plugin that does to the process it runs in what a batch must outlive; which, the number of trees tells."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import NoReturn

import numpy as np
from pydantic import Field

from treereg_core import hookimpl
from treereg_core.method import Context, Method, PointMatcher, Registration
from treereg_core.pair import Pair


def leave() -> NoReturn:
    os._exit(3)


def be_killed() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def hang() -> None:
    time.sleep(3600)


def hoard() -> NoReturn:
    hoarded = [np.empty(2**27) for _ in range(64)]  # a GB each, never touched
    raise AssertionError(f"{len(hoarded)} GB were given")


def err() -> NoReturn:
    raise KeyError("a fault of\nthe plugin")


TROUBLE = {101: leave, 102: be_killed, 103: hang, 104: hoard, 105: err}


class Troubled(PointMatcher):
    """Pairs each source tree with the nearest reference tree, after trouble with some surveys."""

    name = "troubled"
    pause: float = Field(0.0, ge=0, description="how long it waits first", json_schema_extra={"unit": "s"})
    diary: str = Field("", description="a file that is told which process registers")

    def register(self, pair: Pair, context: Context) -> Registration:
        if self.diary:
            with Path(self.diary).open("a") as file:
                file.write(f"{os.getpid()}\n")
        time.sleep(self.pause)
        print("what a plugin prints is no result")
        TROUBLE.get(len(pair.source), int)()
        distance, partner = pair.reference.tree.query(pair.source_in_reference)
        near = np.flatnonzero(distance < 1)
        transform = context.model.fit(pair.source.xy[near], pair.reference.xy[partner[near]])
        pairs = np.column_stack([pair.reference.ids[partner[near]], pair.source.ids[near]])
        return Registration(transform, pairs, np.ones(len(near)))


@hookimpl
def treereg_methods() -> list[type[Method]]:
    return [Troubled]
