"""Score echoes with a bundle, without echolearn: its documented format (docs/formats.md), numpy and onnxruntime.

    python examples/read_bundle.py runs/bundles/best

proves the files by their checksums, replays the golden inputs, and says which of them would be kept. To score echoes of
your own, give `confidence` rows of the columns that `bundle.json` names, in their order and units.
"""

import hashlib
import json
import os
import sys
from pathlib import Path

import numpy as np

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # which onnxruntime would keep in the home folder

import onnxruntime


def read(folder: Path) -> dict:
    """Return the content of `bundle.json`, after proving it and the files it names."""
    text = (folder / "bundle.json").read_bytes()
    about = json.loads(text)
    unsealed = {key: value for key, value in about.items() if key != "sha256"}
    canonical = json.dumps(unsealed, sort_keys=True, separators=(",", ":"))
    if hashlib.sha256(canonical.encode()).hexdigest() != about["sha256"]:
        sys.exit(f"{folder}/bundle.json: damaged")
    if about["schema"] not in (2, 3, 4):
        sys.exit(f"{folder}/bundle.json: schema {about['schema']} is not what this script reads")
    for name, entry in about["files"].items():
        data = (folder / name).read_bytes()
        if (len(data), hashlib.sha256(data).hexdigest()) != (entry["bytes"], entry["sha256"]):
            sys.exit(f"{folder / name}: damaged")
    return about


def confidence(session: onnxruntime.InferenceSession, rows: np.ndarray) -> np.ndarray:
    """Return the belief in each echo, shape (B,), from raw inputs (B, K) or (B, bands, M * M)."""
    return session.run(["confidence"], {"x": np.asarray(rows, dtype=np.float32)})[0]


def main(folder: Path) -> None:
    """Say what a bundle is, and replay its golden inputs."""
    about = read(folder)
    session = onnxruntime.InferenceSession((folder / "model.onnx").read_bytes(), providers=["CPUExecutionProvider"])
    with np.load(folder / "golden.npz", allow_pickle=False) as golden:
        rows, expected = golden["x"], golden["confidence"]
    found, threshold = confidence(session, rows), about["threshold"]["value"]
    names = ", ".join(f"{column['name']} [{column['unit']}]" for column in about["columns"])
    print(f"{about['classifier']}, trained on {about['trained_on']}; looks at {names}")
    print(f"an echo is kept from a confidence of {threshold:.3f}")
    print(f"largest difference from the golden confidences: {np.abs(found - expected).max():.1e}")
    print(f"of {len(rows)} golden inputs {np.sum(found >= threshold)} are kept")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python read_bundle.py <folder of a bundle>")
    try:
        main(Path(sys.argv[1]))
    except OSError as error:
        sys.exit(f"{error.filename}: {error.strerror}")
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        sys.exit(f"{sys.argv[1]}: is no bundle ({type(error).__name__}: {error})")
