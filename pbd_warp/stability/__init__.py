"""The atlas of stability: where methods fail, measured cell by cell.

`maps` says what is swept, `classify` what counts as a failure, `theory` where it should begin; `atlas` measures,
`draw` and `page` show.
"""
