"""CSI logs as the CSI Tool's log_to_file writes them: u16 big-endian length, code, body, record behind record."""

from __future__ import annotations

from pathlib import Path

from csi_bridge.dat_frames import DatFileError
from csi_bridge.encoder import encode_body, encode_file_record
from csi_bridge.records import CSI_CODE, CsiRecord


class DatWriter:
    """Appends records to a new file. Raises DatFileError where it cannot be written, EncodeError for a record that no
    driver reports."""

    def __init__(self, path: str | Path) -> None:
        self._path = Path(path)
        try:
            self._file = self._path.open("wb")
        except OSError as error:
            raise DatFileError(f"{path}: {error.strerror}") from None

    def write(self, code: int, body: bytes) -> None:
        """One record of any code, as it came from the driver."""
        data = encode_file_record(code, body)
        try:
            self._file.write(data)
        except OSError as error:
            raise DatFileError(f"{self._path}: {error.strerror}") from None

    def write_record(self, record: CsiRecord) -> None:
        self.write(CSI_CODE, encode_body(record))

    def close(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            raise DatFileError(f"{self._path}: {error.strerror}") from None

    def __enter__(self) -> DatWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
