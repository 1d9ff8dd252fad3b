"""Tables: named columns of numbers in CSV and Parquet files."""
