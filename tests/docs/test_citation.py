"""CITATION.cff is valid for version 1.2.0 of the format, and agrees with the package's metadata."""

import datetime
import re
import tomllib

import yaml
from markdown import ROOT, text

import redundant_envs as rde

KEYS = {
    "abstract", "authors", "cff-version", "commit", "contact", "date-released", "doi", "identifiers",
    "keywords", "license", "license-url", "message", "preferred-citation", "references", "repository",
    "repository-artifact", "repository-code", "title", "type", "url", "version",
}  # fmt: skip
"""Of https://github.com/citation-file-format/citation-file-format, schema 1.2.0."""
PERSON = {
    "address", "affiliation", "alias", "city", "country", "email", "family-names", "fax", "given-names",
    "name-particle", "name-suffix", "orcid", "post-code", "region", "tel", "website",
}  # fmt: skip
ENTITY = {
    "address", "alias", "city", "country", "date-end", "date-start", "email", "fax", "location", "name",
    "orcid", "post-code", "region", "tel", "website",
}  # fmt: skip


def test_the_citation_file_is_valid_and_agrees_with_the_package():
    cited = yaml.safe_load(text(ROOT / "CITATION.cff"))
    project = tomllib.loads(text(ROOT / "pyproject.toml"))["project"]
    assert {"authors", "cff-version", "message", "title"} <= set(cited) <= KEYS
    assert cited["cff-version"] == "1.2.0"
    assert cited.get("type", "software") in ("software", "dataset")
    for name in ("abstract", "license", "message", "title", "version"):
        assert isinstance(cited[name], str), name
        assert cited[name], name
    assert cited["license"] == project["license"]
    assert "version" in project["dynamic"]  # it is that of the package
    assert cited["version"] == rde.__version__
    assert cited["title"].startswith(f"{project['name']}:")
    assert cited["authors"]
    for author in cited["authors"]:
        assert set(author) <= (ENTITY if "name" in author else PERSON)
        assert all(isinstance(value, str) for value in author.values())
    assert len(set(cited["keywords"])) == len(cited["keywords"]) > 0
    assert all(isinstance(word, str) for word in cited["keywords"])
    if "date-released" in cited:
        assert isinstance(cited["date-released"], datetime.date)
    if "doi" in cited:
        assert re.fullmatch(r"10\.\d{4,9}(\.\d+)?/\S+", cited["doi"])
