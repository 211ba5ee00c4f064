"""The benchmark of planners: any set of planners over any set of grounds."""
