"""The text of a recording's file, out of its archive, or what the file is instead."""

from __future__ import annotations

import io
import tarfile
import zipfile
from pathlib import Path

MAX_BYTES = 500_000_000
# what files that have no table of numbers begin with
_OTHERS = {
    b"\xd0\xcf\x11\xe0": "an old Excel file (.xls): save or export it as CSV",
    b"MATLAB 5.0": "a file of MATLAB (.mat): write a CSV file with writetable or writematrix",
    b"\x89HDF": "an HDF5 file, or one of MATLAB 7.3 (.mat): write a CSV file",
    b"#ROSBAG": "a recording of ROS (.bag): write its joint states as CSV, as PlotJuggler does",
    b"SQLite format 3": "SQLite: ros2 bag convert makes MCAP of a ROS bag (.db3)",
    b"PAR1": "a Parquet file: write it as CSV",
}
_XML = {  # what stands near the beginning of those that are XML
    b"cabrillo.tracker": "a project of Tracker (.trk): export its table by File, Export, Data File",
    b"<phyphox": "an experiment of phyphox without data: export those as CSV",
}


def text_of(data: bytes, path: Path) -> tuple[str, str]:
    """Return the text, and the name, of a file, or of the one in an archive that has the data."""
    name = path.name
    other = [what for begins, what in _OTHERS.items() if data.startswith(begins)]
    if other := other + [what for part, what in _XML.items() if part in data[:300]]:
        raise ValueError(f"{path} is {other[0]}")
    try:
        if data.startswith(b"PK"):
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                names = archive.namelist()
                if "xl/workbook.xml" in names:
                    raise ValueError(f"{path} is an Excel file (.xlsx): save or export it as CSV")
                found = [n for n in names if n.endswith(".csv") and not n.startswith("meta/")]
                if not found:
                    raise ValueError(f"{path} must have a CSV file, got {', '.join(names[:9])}")
                name = min(found, key=lambda each: "gyro" not in each.lower())
                if archive.getinfo(name).file_size > MAX_BYTES:
                    raise ValueError(f"{path} must have at most {MAX_BYTES} bytes")
                data = archive.read(name)
        elif data[257:262] == b"ustar":
            with tarfile.open(fileobj=io.BytesIO(data)) as archive:
                documents = (archive.extractfile(one) for one in archive if one.isfile())
                parts = [one.read() for one in documents if one is not None]
                data = next((part for part in parts if b"<Document" in part), b"")
    except (zipfile.BadZipFile, tarfile.TarError, RuntimeError, NotImplementedError) as error:
        raise ValueError(f"{path} is an archive that cannot be read: {error}") from error
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        return data.decode(encoding), name
    except UnicodeDecodeError as error:
        if encoding != "utf-16" and b"\0" not in data:  # a degree sign of Windows
            return data.decode("cp1252", "replace"), name
        raise ValueError(
            f"{path} must be a CSV file in UTF-8, or an export of a program for measurements; "
            f"save it as CSV in UTF-8: {error}"
        ) from error
