"""The report of a run: `report-data.json`, and `report.html` made of it, one page that needs no network.

`write_report` writes both for a finished run, `write_page` makes the page again from the data.
"""

from treereg_core.report.data import SCHEMA
from treereg_core.report.files import DATA, PAGE, write_page, write_report
from treereg_core.report.page import page

__all__ = ["DATA", "PAGE", "SCHEMA", "page", "write_page", "write_report"]
