"""What GPUs alone need: which there are, fetching through pinned memory, and memory that runs out."""
