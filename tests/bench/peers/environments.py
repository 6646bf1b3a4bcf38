"""What each peer needs, below `build/peers`: an environment of its own, made at the first run."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.peers.bridge import PeerError

HERE = Path(__file__).parent
BUILD = HERE.parents[2] / "build" / "peers"
QUIX, FLINK = "quixstreams==3.28.1", "apache-flink==2.3.0"


def python_of(package: str) -> str:
    """Return the interpreter of an environment with one package. Raises `PeerError`."""
    folder = BUILD / package.replace("==", "-")
    python, made = folder / "bin" / "python", folder / "made"
    if not made.exists():
        with _named(f"{package} cannot be installed"):
            _run(sys.executable, "-m", "venv", str(folder))
            _run(str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", package)
        made.touch()
    return str(python)


def java_command() -> list[str]:
    """Return the command of the Flink job in Java, compiled against the JARs of PyFlink. Raises `PeerError`."""
    if shutil.which("javac") is None:
        raise PeerError("needs javac (Debian: apt-get install default-jdk-headless)")
    jars = f"{flink_library()}/*"
    classes = BUILD / "java"
    with _named("FlinkJob.java cannot be compiled"):
        _run("javac", "-d", str(classes), "-cp", jars, str(HERE / "FlinkJob.java"))
    opened = [f"--add-opens=java.base/java.{package}=ALL-UNNAMED" for package in ("lang", "util")]
    return ["java", *opened, "-cp", f"{jars}:{classes}", "FlinkJob"]


def flink_library() -> Path:
    """Return the folder of Flink's JARs. Raises `PeerError`."""
    if shutil.which("java") is None:
        raise PeerError("needs Java (Debian: apt-get install default-jre-headless)")
    return next(Path(python_of(FLINK)).parents[1].glob("lib/python*/site-packages/pyflink/lib"))


@contextmanager
def _named(problem: str) -> Iterator[None]:
    try:
        yield
    except subprocess.CalledProcessError as error:
        last = (error.stderr or "").strip().rpartition("\n")[2]
        raise PeerError(f"{problem}: {last[:160]}") from None


def _run(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True, text=True)
