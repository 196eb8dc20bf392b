"""How noisy a picture is, and where it needs no more samples."""
