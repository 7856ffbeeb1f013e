"""The YAML files that users write: suites, rigs, recordings."""
