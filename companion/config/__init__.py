"""The configuration of one vehicle or robot: a YAML file in, one frozen `Config` or every error at once out.

`schema` holds the keys, `rules` what must fit each other, `file` reads and writes. Nothing else in the program reads
YAML, and nothing here opens what a configuration names.
"""
