"""Files for other tools: trajectories, evo's results, tables, a layout for viewers of takes."""

FORMATS = ("tum", "evo", "csv", "parquet", "foxglove")
