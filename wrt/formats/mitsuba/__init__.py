"""Scene files of Mitsuba 3, in XML (Jakob et al. 2022, mitsuba-renderer.org): a folder, since it is a whole format.

What is read, how it is mapped and what is not is said in docs/mitsuba.md.
"""
