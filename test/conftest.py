"""Every JSON document that any test lets a command make must fit its schema."""

import jsonschema
import pytest

from stepdiag_ros import schemas


@pytest.fixture(scope="session")
def validators():
    """Return a validator for each schema, by its identifier."""
    return {
        schemas.identifier(name): jsonschema.Draft202012Validator(schemas.schema(name))
        for name in schemas.VERSIONS
    }


@pytest.fixture(autouse=True)
def every_document_fits_its_schema(validators, monkeypatch):
    """Validate documents as they are written, wherever that is in this process."""
    written = schemas.json_text

    def checked(made):
        errors = validators[made["schema"]].iter_errors(made)
        faults = [f"{error.json_path}: {error.message[:200]}" for error in errors]
        assert not faults, "\n".join(faults[:10])
        return written(made)

    monkeypatch.setattr(schemas, "json_text", checked)
