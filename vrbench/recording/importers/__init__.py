"""Built-in importers: each module holds one format's `IMPORTER`."""
