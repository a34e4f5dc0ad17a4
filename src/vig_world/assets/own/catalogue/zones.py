"""Zones of the generator's rooms for a catalogue's things, by their names, tags and categories."""

import re

_BY_CATEGORY_ALONE = {
    "bathroom": ("washing",),
    "characters": ("floor",),
    "exterior": ("floor",),
    "staircases": ("floor",),
    "vehicles": ("floor",),
    "doors and windows": ("floor",),
}
"""Categories whose things belong in one place, whatever their names."""
_BY_CATEGORY = {
    "kitchen": ("cooking", "dining"),
    "bedroom": ("bedside",),
    "office": ("desk",),
    "living room": ("display", "reading"),
    "lights": ("bedside", "desk", "reading"),
    "miscellaneous": ("storage", "display"),
}
"""Other categories, for things of which neither name nor tags are below."""
_WORDS = {
    ("dining", "cooking"): "food cake bread fruit salad sugar salt plate bowl cutlery fork spoon",
    ("dining", "drinks"): "drink bottle cup mug glass teapot creamer jar pottery kettle press",
    ("cooking",): "pan knife utensil cooker oven stove hob toaster blender mixer scale board squeezer",
    ("desk",): "computer laptop printer pencil pen penbox stapler ruler calendar phone",
    ("reading", "desk"): "book newspaper camera tablet remote joystick glasses sunglasses watch keys money",
    ("display", "reading"): "candle vase flower plant frame decoration toy doll game puzzle rubik",
    ("display", "storage"): "radio music speaker stereo dvd tv electronics",
    ("bedside", "storage"): "clothes shoes slippers sneakers hat cap towel handbag jewelry clock alarm",
    ("storage", "floor"): "box basket crate tape gift suitcase backpack helmet locker drill hammer",
    ("floor",): "animal trash dustbin doormat ball basketball broom shovel pallet barrel",
}
"""Zones by a word of the name (the last counts first), or else of the tags."""
_ZONES = {word: zones for zones, words in _WORDS.items() for word in words.split()}


def head_words(name: str) -> list[str]:
    """Return the words of a thing's name that name its kind: `bowl` of "Bowl with fruits, red".

    Returns:
        Lower-case words of letters, not one of them after a comma or a preposition.
    """
    head = re.split(r",| - |\b(?:with|of|and|in|on|under|for)\b", name.casefold())[0]
    return re.findall(r"[^\W\d_]+", head) or re.findall(r"[^\W\d_]+", name.casefold())


def zones_of(name: str, tags: tuple[str, ...], category: str) -> tuple[str, ...]:
    """Return the zones in which a thing belongs: some of `ZONE_NAMES`; empty for any.

    Args:
        name: Such as "Coffee cup".
        tags: Such as ("Food", "Drink").
        category: Such as "Kitchen".
    """
    category = category.casefold()
    if category in _BY_CATEGORY_ALONE:
        return _BY_CATEGORY_ALONE[category]
    words = [*reversed(head_words(name)), *(word for tag in tags for word in head_words(tag))]
    for word in words:
        for form in (word, word.removesuffix("s")):
            if form in _ZONES:
                return _ZONES[form]
    return _BY_CATEGORY.get(category, ())
