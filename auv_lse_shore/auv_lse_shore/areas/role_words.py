"""The words that state what a feature of an area file is for: one table for all formats.

They are whole words, as `words` separates them, without capitals and accents. Those for no-go areas are English,
German, French, Spanish, Italian, Portuguese, Dutch and Scandinavian.
"""

import re

from auv_lse_shore.areas.features import words

_ZONES = r"(?:zones?|areas?|polygons?|waters)"
#: Vehicles must stay out, whatever else the text states.
_KEEP_OUT = (
    r"no ?go|no ?entry|exclu(?:sion|sive|de|ded)|keep ?(?:out|away|clear)|stay out|off limits|do not enter"
    rf"|closed {_ZONES}|{_ZONES} closed"
    r"|(?:ge)?sperr\w*|verbot\w*|ausschluss\w*"
    r"|interdi\w*|zones? fermees?"
    r"|prohibid\w*|zonas? cerradas?"
    r"|vietat\w*|esclusion[ei]|zon[ae] chius[ae]"
    r"|proibid\w*|exclusao"
    r"|verboden|forbjud\w*|forbud\w*"
)
#: These are no-go areas, too, but may be a part of a lake's name.
_RISKS = r"avoid|forbidden|prohibited|restricted|dangers?|dangerous|hazards?"
_OBJECTS = (
    r"obstacles?|obstructions?|islands?|islets?|isles?|rocks?"
    r"|hindernisse?|inseln?|fels|felsen|klippen?"
    r"|iles?|ilots?|rochers?"
    r"|obstaculos?|islas?|islotes?|rocas?"
    r"|ostacol[oi]|isol[ae]|isolott[oi]|scogli|scoglio|rocc[ei]a?"
    r"|ilhas?|ilheus?|rochas?"
    r"|eiland|eilanden|rotsen|holme|holmen|skar|skjær"
)
#: Waters that are named after them: "Island Lake", "Rock Creek", "Lac de l'Île".
_NAMED_WATERS = re.compile(
    rf"\b(?:{_RISKS}|{_OBJECTS}) (?:lakes?|reservoir|ponds?|loch|lough|lagoon|tarn|meer|see)\b"
    rf"|\b(?:{_OBJECTS}) (?:creek|river|bay|cove|inlet|harbou?r|quarry|pool)\b"
    r"|\b(?:lakes? of|lac|etang|lago|laguna|lagoa|embalse)(?: (?:the|de|des|du|d|l|la|las|los|el|del|dell\w?|della"
    rf"|delle|degli|di|da|das|do|dos))* (?:{_OBJECTS})\b"
)
#: The words of each role. The first role with a word in the text counts.
_ROLES = {
    "no_go": re.compile(rf"\b(?:{_KEEP_OUT}|{_RISKS}|{_OBJECTS})\b"),
    "start": re.compile(r"\b(start|launch)\b"),
    "recovery": re.compile(r"\b(recovery|rally|pick ?up|home)\b"),
    "shore": re.compile(r"\b(shore|shoreline|coastline)\b"),
    "area": re.compile(r"\b(area|survey|operating|boundary|perimeter|inclu(sion|sive|de|ded)|geofence)\b"),
}
_ANY_KEEP_OUT = re.compile(rf"\b(?:{_KEEP_OUT})\b")
#: Titles of documents that hold no-go areas and nothing else.
_NO_GO_TITLE = re.compile(
    rf"(?!.*\b(?:and|und|et|with|plus|survey|mission|operating|boundary|perimeter|incl|inclu\w*|geofence|start"
    rf"|launch|recovery)\b)"
    rf"(?:.*\b(?:{_KEEP_OUT})\b.*|.*\b(?:{_RISKS}) {_ZONES}\b.*"
    rf"|(?:{_RISKS}|{_OBJECTS})(?: {_ZONES})?(?: \d+)?(?: km[lz])?(?: \d+)?)"
)


def stated_role(text: str) -> str:
    """The role that a text states: no_go, start, recovery, shore or area; "" if none."""
    found = _NAMED_WATERS.sub(" ", words(text))
    return next((role for role, pattern in _ROLES.items() if pattern.search(found)), "")


def states_keep_out(text: str) -> bool:
    """Whether a text states that vehicles must stay out, and does not only name an object or a risk."""
    return _ANY_KEEP_OUT.search(words(text)) is not None


def is_no_go_title(text: str) -> bool:
    """Whether a document states by its title that it holds only no-go areas: lakes are named after islands, too."""
    return _NO_GO_TITLE.fullmatch(words(text)) is not None
