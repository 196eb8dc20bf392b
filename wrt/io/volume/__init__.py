"""Files of volumes: NumPy, Mitsuba's .vol, NanoVDB."""
