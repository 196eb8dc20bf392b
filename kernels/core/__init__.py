"""What all device code is made of: records, elementary functions, features; it imports nothing above."""
