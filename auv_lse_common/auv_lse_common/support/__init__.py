"""Small tools without a subject of their own: compilation, lazy imports, error texts, files written whole."""
