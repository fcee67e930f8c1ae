"""Reading and checking of all user input: YAML files, options, parameters.

Every complaint is one sentence that names the file, the field, the value and the remedy. Files
are described by a `ConfigModel`, parameters of the program by dataclasses whose annotations say
which values are good (`check_fields`), single arguments by the functions `as_...`.
"""

from ambinav.config.files import parse_yaml, read_text
from ambinav.config.model import (
    ConfigModel,
    check_fields,
    check_keys,
    checked,
    from_mapping,
    of_mapping,
    require,
)
from ambinav.config.numbers import (
    as_arrays,
    as_count,
    as_degrees,
    as_flat,
    as_nonnegative,
    as_number,
    as_numbers,
    as_positive,
    nearest,
)
from ambinav.config.values import (
    Count,
    Degrees,
    FaultError,
    MountDegrees,
    NonNegative,
    Number,
    Numbers,
    Positive,
    Share,
    Switch,
    Text,
    check_kind,
    choice,
    fault,
    integer,
    number,
    row,
    some_numbers,
)

__all__ = [
    "ConfigModel",
    "Count",
    "Degrees",
    "FaultError",
    "MountDegrees",
    "NonNegative",
    "Number",
    "Numbers",
    "Positive",
    "Share",
    "Switch",
    "Text",
    "as_arrays",
    "as_count",
    "as_degrees",
    "as_flat",
    "as_nonnegative",
    "as_number",
    "as_numbers",
    "as_positive",
    "check_fields",
    "check_keys",
    "check_kind",
    "checked",
    "choice",
    "fault",
    "from_mapping",
    "integer",
    "nearest",
    "number",
    "of_mapping",
    "parse_yaml",
    "read_text",
    "require",
    "row",
    "some_numbers",
]
