"""A mission's results for other programs: GeoTIFF, ASCII grid, GeoJSON, CSV, and a QGIS project that opens them."""
