"""The real-time techniques, one module per source system, grouped by theme."""
