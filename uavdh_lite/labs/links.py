"""Links to the labs' page: the letters that stand behind the # of its address."""

import base64
import json

from uavdh_lite.city import City
from uavdh_lite.errors import InputError
from uavdh_lite.missions import FORMAT, LARGEST, VERSION, Mission, as_json, read_mission

COPIED = "Link copied. It is in the address bar, too."
HERE = "The link is in the address bar: copy it from there."
AGAIN = "Copy it again, as a whole"


def encode(data: bytes) -> str:
    """Data in the URL-safe letters of base64, which mail and chat programs leave as they are."""
    return base64.urlsafe_b64encode(data).decode().rstrip("=")


def decode(code: str) -> bytes:
    """The data of a link, also of an old one, with + and / and =; `ValueError` if it has none."""
    code = code.rstrip("=").replace("-", "+").replace("_", "/")
    return base64.b64decode(code + "=" * (-len(code) % 4), validate=True)


def mission_code(mission: Mission) -> str:
    """A mission without its city."""
    left_out = {"format", "version", "city"}
    values = {name: value for name, value in as_json(mission).items() if name not in left_out}
    return encode(json.dumps(values, separators=(",", ":")).encode())


def mission_in(code: str, city: City) -> Mission:
    """The mission of a code, in this city; `InputError` if it cannot be."""
    try:
        values = dict(json.loads(decode(code)))
    except (ValueError, TypeError, RecursionError):
        raise InputError("part of it is missing") from None
    place = {"name": city.name, "rows": city.text.split()}
    return read_mission(json.dumps(values | {"format": FORMAT, "version": VERSION, "city": place}))


def mission_file(mission: Mission) -> bytes:
    """A mission's file, with its city."""
    return json.dumps(as_json(mission)).encode()


def encoded_mission(mission: Mission) -> str:
    """A mission's file as it stands in a link."""
    return encode(mission_file(mission))


def mission_of_link(code: str) -> Mission:
    """The mission of a link that holds its file; `InputError` if it holds none."""
    try:
        return read_mission(decode(code).decode())
    except InputError as error:
        raise InputError(f"the link holds no mission: {error}. {AGAIN}") from None
    except ValueError:
        raise InputError(f"the link holds no mission: part of it is missing. {AGAIN}") from None


def mission_of_file(data: bytes) -> Mission:
    """The mission of an uploaded file; `InputError` if it holds none."""
    if len(data) > LARGEST:
        raise InputError(f"{len(data):,} bytes: no mission is that large")
    try:
        return read_mission(data.decode())
    except UnicodeDecodeError:
        raise InputError("not a JSON file") from None
