"""Tables: named columns of numbers in text, Parquet and HDF5 files.

From a file to named columns: `csv` (its `layout`, `text_cells`), `parquet` and `hdf5` (`hdf5_columns`; both give
`batch`es); one of the `episodes` of a set. From names to what they hold: `names` reads one, in `units`; `header` judges
all of a table's side by side; `roles` chooses the wrench, the times and the position, `orientations` the orientation.
`table` puts both together; `doubts` says what may be wrong in the result; `write` writes one.
"""
