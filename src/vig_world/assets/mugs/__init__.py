"""Mugs."""
