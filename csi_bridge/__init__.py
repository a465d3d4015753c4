"""The radio: bytes to CSI records and back.

Public: `records` (CsiRecord, MpduRecord, CsiError), `parser` (parse_body, CsiLogParser), `encoder` (encode_body,
encode_file_record), `dat` (read_dat), `source` (CsiSource), `netlink` (NetlinkSource, NetlinkFeeder), `unix_socket`
(UnixSource, UnixFeeder) and `clock` (NicClock).
"""
