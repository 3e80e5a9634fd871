"""One orchard: its surveys registered, and its folder written as `treereg run` writes it."""

from __future__ import annotations

import time
from functools import cache

from treereg_core import io
from treereg_core.api import execute
from treereg_core.batch.order import RECORD, Order, write_record
from treereg_core.batch.outcome import Outcome, Word
from treereg_core.errors import TreeregError, in_words
from treereg_core.io.output import RUN_NAMES
from treereg_core.options import Options
from treereg_core.outputs import write_result
from treereg_core.pipeline import Clock
from treereg_core.plan import Plan, plan_for
from treereg_core.registry import installed
from treereg_core.report import write_report
from treereg_core.survey_rasters import raster_plan


def carry_out(order: Order, attempt: int) -> Outcome:
    """Register one orchard and write its folder; what goes wrong becomes an outcome, and then nothing is written."""
    begin = time.monotonic()
    try:
        return register_into_folder(order, attempt, begin)
    except TreeregError as error:
        word, reason = Word.UNUSABLE, str(error)
    except MemoryError:
        word, reason = Word.MEMORY, "memory ran out; give it more, or let fewer orchards run at a time."
    except OSError as error:
        word, reason = Word.CRASHED, f"the system refused ({error.strerror or error})."
    except Exception as error:
        word, reason = Word.CRASHED, f"a fault of treereg or a plugin, please report it ({in_words(error)})."
    return Outcome(order.orchard, word, reason, seconds=time.monotonic() - begin, attempts=attempt)


def register_into_folder(order: Order, attempt: int, begin: float) -> Outcome:
    """Register, and write the files of a run and the record of them. Raises what `read_surveys` and the rest raise."""
    digest, work, clock = order.digest, order.work, Clock()
    plan = plan_of(work.options.model_dump_json())
    folders = (order.reference, order.source)
    place = io.OutputFolder(order.folder, inputs=folders, overwrite=True, names=(*RUN_NAMES, RECORD))
    with place as folder:
        with clock("read"):
            surveys = io.read_surveys(
                *folders, confidence_property=work.confidence_property, same_place=plan.start_file is None
            )
        moving = raster_plan(surveys, work.rasters, folder) if work.rasters else None
        result = execute(plan, surveys, clock)
        written = write_result(result, folder, work.force, moving)
        more = write_report(result, folder)
        said = (surveys[0].warnings, surveys[1].warnings, moving.warnings if moving else (), result.warnings)
        outcome = Outcome.of(
            order.orchard,
            result,
            seconds=round(time.monotonic() - begin, 3),
            attempts=attempt,
            warnings=(*(warning for some in said for warning in some), *written.warnings, *more),
        )
        write_record(folder, digest, outcome)
    return outcome


@cache
def plan_of(options: str) -> Plan:
    """The plan of options, given as JSON; settled once in a process."""
    return plan_for(Options.model_validate_json(options), installed())
