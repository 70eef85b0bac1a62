"""Evidence from many runs: learning curves and tables with their uncertainty."""
