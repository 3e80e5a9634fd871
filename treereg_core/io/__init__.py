"""Files in, files out: the only place that knows geopandas, pyogrio and rasterio.

`read_survey` and `read_surveys` read survey folders into one working frame, `read_transform` the transform in a file;
`write_registered`, `write_matches` and `write_json` write what a registration gives, into an `OutputFolder`;
`write_rows` writes the rows of one survey.
"""

from treereg_core.io.output import RUN_NAMES, SIMULATION_NAMES, OutputFolder
from treereg_core.io.reading import read_survey, read_surveys
from treereg_core.io.transforms import read_transform
from treereg_core.io.writing import is_survey_file, write_json, write_matches, write_registered, write_rows

__all__ = [
    "RUN_NAMES",
    "SIMULATION_NAMES",
    "OutputFolder",
    "is_survey_file",
    "read_survey",
    "read_surveys",
    "read_transform",
    "write_json",
    "write_matches",
    "write_registered",
    "write_rows",
]
