"""Lists what comes with maquette: a software bill of materials in CycloneDX 1.6 JSON.

    python tools/sbom.py > sbom.json

It names the locked dependencies (requirements/run.txt), the packages bundled into the page's editor and the fonts, with their hashes. It
is the same for the same sources.
"""

# The decorators of cyclonedx-python-lib hide the types of its classes.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

import base64
import hashlib
import json
import re
import tomllib
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cyclonedx.model import ExternalReference, ExternalReferenceType, HashAlgorithm, HashType, Property, XsUri
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.model.license import DisjunctiveLicense, LicenseExpression
from cyclonedx.output.json import JsonV1Dot6
from maquette.lang import distribution
from packageurl import PackageURL

ROOT = Path(__file__).resolve().parent.parent
_PIN = re.compile(r"^([\w.-]+)==(\S+)(?: ; (.*?))? \\\n((?:    --hash=\S+(?: \\)?\n)+)", re.MULTILINE)
_TOOLS = ("node_modules/esbuild", "node_modules/@esbuild/")  # build the bundle and are not in it


def dependencies() -> Iterator[Component]:
    """The packages that maquette needs. Each has several files: one for each system and version of Python."""
    for name, version, marker, hashes in _PIN.findall((ROOT / "requirements" / "run.txt").read_text(encoding="utf-8")):
        digests = [HashType(alg=HashAlgorithm.SHA_256, content=each) for each in re.findall(r"sha256:(\w+)", hashes)]
        files = ExternalReference(type=ExternalReferenceType.DISTRIBUTION, url=XsUri(f"https://pypi.org/simple/{name}/"), hashes=digests)
        address = PackageURL("pypi", None, name, version)
        conditions = [Property(name="maquette:marker", value=marker)] if marker else []
        yield Component(
            name=name, version=version, purl=address, bom_ref=str(address), external_references=[files], properties=conditions
        )  # fmt: skip


def bundled() -> Iterator[Component]:
    """The packages of npm inside live/page/codemirror.js, and the fonts of stdlib."""
    lock = json.loads((ROOT / "tools" / "editor" / "package-lock.json").read_text(encoding="utf-8"))
    for path, about in lock["packages"].items():
        if path and not path.startswith(_TOOLS):
            full = path.removeprefix("node_modules/")
            address = PackageURL("npm", full.rpartition("/")[0], full.rpartition("/")[2], about["version"])
            digest = HashType(alg=HashAlgorithm.SHA_512, content=base64.b64decode(about["integrity"].removeprefix("sha512-")).hex())
            yield Component(
                name=full, version=about["version"], purl=address, bom_ref=str(address), hashes=[digest],
                licenses=[DisjunctiveLicense(id=about["license"])],
            )  # fmt: skip
    for path in sorted((ROOT / "stdlib" / "fonts").glob("*.ttf")):
        digest = HashType(alg=HashAlgorithm.SHA_256, content=hashlib.sha256(path.read_bytes()).hexdigest())
        licenses = [DisjunctiveLicense(id="Bitstream-Vera")]
        yield Component(name=path.name, type=ComponentType.FILE, bom_ref=f"font:{path.name}", hashes=[digest], licenses=licenses)


def bill() -> str:
    """The bill of materials as JSON."""
    licence = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["license"]
    address = PackageURL("pypi", None, distribution.NAME, distribution.VERSION)
    product = Component(
        name=distribution.NAME, version=distribution.VERSION, type=ComponentType.APPLICATION, purl=address, bom_ref=str(address),
        licenses=[LicenseExpression(licence)],
    )  # fmt: skip
    parts = [*dependencies(), *bundled()]
    bom = Bom(components=parts)
    bom.metadata.component = product
    bom.register_dependency(product, parts)
    text: dict[str, Any] = json.loads(JsonV1Dot6(bom).output_as_string())
    del text["metadata"]["timestamp"], text["serialNumber"]
    content = json.dumps(text, sort_keys=True)
    text["serialNumber"] = f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, content)}"
    return json.dumps(text, indent=2, sort_keys=True) + "\n"


if __name__ == "__main__":
    print(bill(), end="")
