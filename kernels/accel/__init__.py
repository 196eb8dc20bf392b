"""Acceleration structures: ray trees and the rays through them."""
