"""Tables of readings: CSV and Parquet, by a mapping of their columns."""
