"""Recording: from sources and files to takes."""
