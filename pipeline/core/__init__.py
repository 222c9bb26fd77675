"""Configuration, tables, random streams, errors and trials: the layer below all others."""
