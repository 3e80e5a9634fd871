"""Files in, files out: the only place that knows geopandas, pyogrio and rasterio.

`read_survey` and `read_surveys` read survey folders into one working frame.
"""

from treereg_core.io.reading import read_survey, read_surveys

__all__ = ["read_survey", "read_surveys"]
