"""Speed, memory and accuracy of vrbench, beside its peers; see docs/performance.md."""
