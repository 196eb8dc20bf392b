"""What the tests share: statistics, and a bridge to an independent renderer."""
