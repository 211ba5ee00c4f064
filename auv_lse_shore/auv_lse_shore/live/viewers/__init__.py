"""Who the live view is shown to: the page, Foxglove, RViz."""
