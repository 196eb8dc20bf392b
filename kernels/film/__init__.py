"""The film: filters, sums of samples, and layers."""
