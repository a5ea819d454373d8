"""Reads a sweep's table in both its formats with pandas and compares them."""

import sys
from pathlib import Path

import pandas

folder = Path(sys.argv[1])
parquet = pandas.read_parquet(folder / "table.parquet")
csv = pandas.read_csv(folder / "table.csv", keep_default_na=False, na_values=[""])
pandas.testing.assert_frame_equal(parquet, csv, check_dtype=False)
assert parquet["run"].is_monotonic_increasing and parquet["energy_j"].dtype == "float64"
print(f"{len(parquet)} rows")
