"""Built-in importers: each module holds the `IMPORTERS` of one format."""
