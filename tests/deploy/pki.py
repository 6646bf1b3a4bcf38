"""A certificate authority for a test, made with the openssl command."""

import shutil
import subprocess
from pathlib import Path

import pytest

_NEW_KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")


class Authority:
    """Issues certificates for 127.0.0.1 into a folder: `<name>.crt` and `<name>.key`."""

    def __init__(self, folder: Path, name: str = "ca") -> None:
        if shutil.which("openssl") is None:
            pytest.skip("openssl is not installed")
        self.folder = folder
        self.name = name
        self._openssl(
            "req", "-x509", *_NEW_KEY, "-keyout", f"{name}.key", "-out", f"{name}.crt", "-subj", f"/CN={name}"
        )

    def issue(self, name: str, *, file: str | None = None, days: int = 30) -> None:
        """Issue a certificate of a name, in files of that name or another; one of less than 0 days has expired."""
        file = file or name
        request = ("-keyout", f"{file}.key", "-out", f"{file}.csr", "-subj", f"/CN={name}")
        self._openssl("req", *_NEW_KEY, *request, "-addext", "subjectAltName=IP:127.0.0.1")
        signer = ("-CA", f"{self.name}.crt", "-CAkey", f"{self.name}.key", "-CAcreateserial")
        signed = ("-in", f"{file}.csr", "-out", f"{file}.crt", "-days", str(days))
        self._openssl("x509", "-req", *signed, *signer, "-copy_extensions", "copy")

    def _openssl(self, *arguments: str) -> None:
        subprocess.run(["openssl", *arguments], cwd=self.folder, check=True, capture_output=True, timeout=30)
