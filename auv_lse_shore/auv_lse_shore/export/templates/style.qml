<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
{% from "qgis_parts.xml" import style %}
<qgis version="3.22.0">
{{ style(layer) }}
</qgis>
