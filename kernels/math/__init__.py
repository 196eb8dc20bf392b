"""Elementary functions inlined as arithmetic, which vectorises."""
