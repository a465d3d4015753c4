"""The radio: bytes to CSI records and back.

Public: `records` (CsiRecord, MpduRecord, CsiError), `parser` (parse_body, CsiLogParser), `encoder` (encode_body,
encode_file_record), `dat` (read_dat), `dat_writer` (DatWriter), `scaling` (scaled_csi, without_spatial_mapping),
`source` (CsiSource), `netlink` (NetlinkSource, NetlinkFeeder), `unix_socket` (UnixSource, UnixFeeder), `replay`
(read_tape, play), `clock` (NicClock) and `injector` (Injector, ping_frame). `feitcsi` is the same for Intel AX200 and
AX210, `foreign` names the files of other tools.
"""
