"""Parts of a render, which other processes or machines make, and the picture that they are merged to."""
