"""What a person describes: shapes, materials, lights, camera, settings. Plain data, NumPy only."""
