"""Intel AX200 and AX210 with the FeitCSI driver: its bytes to records and back.

Public: `records` (FeitRecord, FEITCSI_CODE), `parser` (parse_record, FeitLogParser), `encoder` (encode_record), `rate`
(Rate), `tones` (what each subcarrier of a report is), `channel` (the channel without what card and standard add), `log`
(parse_log, is_feitcsi), `message` and `netlink` (vendor events of nl80211). The parser does no I/O and raises only
CsiError. Hardware unverified: checked on public captures.
"""
