"""The parameters of the accuracies, from the server."""

from . import client
from .messages import v1
from .schema import GROUPS, title

_MESSAGES = {name: message for message, name in GROUPS.items()}


def text(group, field):
    """The value that a parameter has where it is not set; a dash if that is not known or depends on the scene."""
    settings = group.id_data.cairn
    message = next(name for name in _MESSAGES if getattr(settings, name, None) == group)
    parameters = _parameters(getattr(v1, f"ACCURACY_{settings.accuracy}"))
    if parameters is None:
        # Before the server has answered: the schema's defaults are the standard's.
        known = field["default"] if settings.accuracy == "STANDARD" else None
        return "–" if known is None else title(known)
    values = getattr(parameters, message)
    name = field["name"]
    if values.DESCRIPTOR.fields_by_name[name].has_presence and not values.HasField(name):
        return "–"
    value = getattr(values, name)
    if field["kind"] == "bool":
        return "On" if value else "Off"
    if field["kind"] == "enum":
        return next((title(item) for item, _, number in field["items"] if number == value), "–")
    return f"{value:.4g}" if field["kind"] == "float" else str(value)


def _parameters(accuracy):
    for preset in client.info.accuracy_presets if client.info else ():
        if preset.accuracy == accuracy:
            return preset.parameters
    return None
