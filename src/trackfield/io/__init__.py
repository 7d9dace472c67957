"""Files in and out: the only rooms that know names of columns on disk.

`measurements`, `truth`, `tracks` hold what a caller needs, `recorded` public recordings, `geodesy`
the local frame on the Earth. Way in: `lines` -> `csv_tables`, `ndjson_tables`, or `arrow` ->
`tables` (checks). Way out: `writing` -> `output` (complete or not at all).
"""
