"""A batch: many orchards, each registered in a process of its own, whatever becomes of the others.

`read_manifest` says which orchards, `Work` what is to be done with each, `BatchFolder` where the results go and which
of them are there already; `run_batch` does the rest on local processes (`local`) or on a Dask cluster (`cluster`).
"""

from treereg_core.batch.cluster import cluster
from treereg_core.batch.files import PAGE, SUMMARY, write_summary
from treereg_core.batch.folder import BatchFolder
from treereg_core.batch.manifest import Row, read_manifest
from treereg_core.batch.order import Limits, Order, Work
from treereg_core.batch.outcome import Outcome, Word
from treereg_core.batch.running import Workers, local, run_batch

__all__ = [
    "PAGE",
    "SUMMARY",
    "BatchFolder",
    "Limits",
    "Order",
    "Outcome",
    "Row",
    "Word",
    "Work",
    "Workers",
    "cluster",
    "local",
    "read_manifest",
    "run_batch",
    "write_summary",
]
