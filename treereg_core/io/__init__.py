"""Files in, files out: the only place that knows geopandas, pyogrio and rasterio.

`read_survey` and `read_surveys` read survey folders into one working frame, `read_transform` the transform in a file;
`write_registered`, `write_matches` and `write_json` write what a registration gives, into an `OutputFolder`;
`read_raster` and `raster_job` check a raster and say what moving it will do, which a `RasterJob` then does;
`move_vector` moves a vector file; `registered_geoframe`, `matches_geoframe` and `move_geoframe` do the same in memory;
`write_rows` writes the rows of one survey, `read_series` reads the surveys of a series, `write_tree_table` and
`write_tree_points` write its trees. `read_memory` and `write_memory` keep what an orchard's surveys taught.
`read_images` and `read_checkpoints` read what evaluators compare, `read_preview` what a report shows.
"""

from treereg_core.io.checkpoints import read_checkpoints
from treereg_core.io.crs import full_coordinates, parse_crs
from treereg_core.io.files import find_files, read_json
from treereg_core.io.geoframes import is_geoframe, matches_geoframe, move_geoframe, registered_geoframe
from treereg_core.io.grid import Grid, Motion
from treereg_core.io.images import read_image, read_images
from treereg_core.io.memory import (
    MEMORY,
    check_memory_folder,
    check_value,
    damaged,
    memory_lock,
    read_memory,
    write_memory,
)
from treereg_core.io.output import RUN_NAMES, SIMULATION_NAMES, OutputFolder
from treereg_core.io.preview import Preview, read_preview
from treereg_core.io.raster import Raster, read_raster
from treereg_core.io.rasters import Extent, RasterJob, RasterOptions, check_raster_space, raster_job, raster_outline
from treereg_core.io.reading import read_series, read_survey, read_surveys
from treereg_core.io.resampling import Resampling
from treereg_core.io.staging import settle_left
from treereg_core.io.transforms import full_from_frame, read_motion, read_transform
from treereg_core.io.trees import write_tree_points, write_tree_table
from treereg_core.io.unchanged import stamp, stamps, unchanged
from treereg_core.io.vectors import holds_geojson, is_vector, move_vector, vector_names
from treereg_core.io.writing import is_survey_file, write_json, write_matches, write_registered, write_rows, write_text

__all__ = [
    "MEMORY",
    "RUN_NAMES",
    "SIMULATION_NAMES",
    "Extent",
    "Grid",
    "Motion",
    "OutputFolder",
    "Preview",
    "Raster",
    "RasterJob",
    "RasterOptions",
    "Resampling",
    "check_memory_folder",
    "check_raster_space",
    "check_value",
    "damaged",
    "find_files",
    "full_coordinates",
    "full_from_frame",
    "holds_geojson",
    "is_geoframe",
    "is_survey_file",
    "is_vector",
    "matches_geoframe",
    "memory_lock",
    "move_geoframe",
    "move_vector",
    "parse_crs",
    "raster_job",
    "raster_outline",
    "read_checkpoints",
    "read_image",
    "read_images",
    "read_json",
    "read_memory",
    "read_motion",
    "read_preview",
    "read_raster",
    "read_series",
    "read_survey",
    "read_surveys",
    "read_transform",
    "registered_geoframe",
    "settle_left",
    "stamp",
    "stamps",
    "unchanged",
    "vector_names",
    "write_json",
    "write_matches",
    "write_memory",
    "write_registered",
    "write_rows",
    "write_text",
    "write_tree_points",
    "write_tree_table",
]
