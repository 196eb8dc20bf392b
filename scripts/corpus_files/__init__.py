"""What `scripts/make_corpus.py` writes, a module for each group of kinds."""
