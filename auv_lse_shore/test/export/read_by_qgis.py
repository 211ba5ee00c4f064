"""Run by the system's Python, which alone has QGIS: opens a project, draws it, and prints what it found (JSON)."""

import json
import sys

from qgis.core import (
    QgsApplication,
    QgsCoordinateTransform,
    QgsMapRendererParallelJob,
    QgsMapSettings,
    QgsProject,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QSize

path, picture = sys.argv[1:]
application = QgsApplication([], False)
application.initQgis()
project = QgsProject.instance()
is_read = project.read(path)
shown = [node.layer() for node in project.layerTreeRoot().findLayers() if node.isVisible()]
layers = []
for layer in project.mapLayers().values():
    extent = layer.extent()
    if layer.crs().isValid() and project.crs().isValid():
        extent = QgsCoordinateTransform(layer.crs(), project.crs(), project).transformBoundingBox(extent)
    layers.append(
        {
            "name": layer.name(),
            "valid": layer.isValid(),
            "shown": layer in shown,
            "extent": [extent.xMinimum(), extent.yMinimum(), extent.xMaximum(), extent.yMaximum()],
            "features": layer.featureCount() if isinstance(layer, QgsVectorLayer) else None,
        }
    )
settings = QgsMapSettings()
settings.setLayers(shown)
settings.setDestinationCrs(project.crs())
settings.setExtent(settings.fullExtent())
settings.setOutputSize(QSize(400, 400))
job = QgsMapRendererParallelJob(settings)
job.start()
job.waitForFinished()
job.renderedImage().save(picture)
print(json.dumps({"read": is_read, "layers": layers, "errors": [error.message for error in job.errors()]}))
application.exitQgis()
