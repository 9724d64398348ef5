"""python -m occontrol.files.schema: write the JSON Schemas that the package ships."""

from occontrol.files.schema.json_schema import write_all

write_all()
