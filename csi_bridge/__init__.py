"""The radio's bytes: driver, sockets and files to CSI records, and back.

Bytes come in from a `source` (`netlink`, the patched driver; `unix_socket`, the same messages as datagrams; `draining`
reads either) or a file (`dat`; `replay` plays one at its own pace), `records` go out (`parser`; `encoder` and
`connector` the other way; `payload` is the packed channel inside). `scaling` gives absolute units, `clock` the card's
time on the host's, `injector` puts pings on the air. `feitcsi` is the same for Intel AX200 and AX210, `foreign` names
the files of other tools. Touches netlink, raw and Unix sockets and files; it knows neither robots nor positions, and
imports nothing of the other packages.
"""
