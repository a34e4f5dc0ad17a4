"""What stands where: the functional zones of each family of props."""

from __future__ import annotations

_FAMILIES: dict[str, str] = {
    "cooking": (
        "bowl jug shaker can bottle jar tin carton printed_box orange lemon apple cutting_board saucepan "
        "frying_pan kettle utensils toaster egg_box rolling_pin tray milk_bottle tea_packet bread cheese "
        "tomato pepper carrot grapes tea_towel paper_roll lunch_tin fruit_bowl basket plate mug banana "
        "pear sugar_bowl radio"
    ),
    "dining": (
        "bowl plate mug jug tumbler candle shaker egg_cup cutlery napkin apple orange banana pear "
        "vase_plant cup_saucer goblet sugar_bowl milk_bottle bottle bread croissant cheese cake grapes "
        "fruit_bowl place_mat coaster table_runner tray vase_flowers basket tea_towel newspaper teacups"
    ),
    "drinks": (
        "mug jug tumbler cup_saucer goblet sugar_bowl milk_bottle bottle can carton coaster tray teacups "
        "tea_packet flask kettle lemon tin napkin croissant cake table_runner egg_cup"
    ),
    "desk": (
        "mug pen_pot book book_stack tissue_box lamp clock speaker frame pot_plant succulent "
        "paper_sheets notebook pencils envelope open_book magazine tape scissors phone tablet laptop "
        "keyboard mouse headphones cable calculator camera spectacles keys globe cup_saucer wallet torch "
        "flask hourglass"
    ),
    "reading": (
        "book book_stack magazine newspaper open_book spectacles mug cup_saucer coaster lamp candle "
        "remote_control tablet frame pot_plant vase_flowers wool teacups cushion notebook tissue_box "
        "teddy apple"
    ),
    "display": (
        "frame clock vase_plant pot_plant vase_flowers succulent figurine bell lantern candle wooden_box "
        "jewellery_box hourglass globe camera jug bowl toy_car book book_stack radio speaker plate "
        "goblet lamp jar basket teacups"
    ),
    "storage": (
        "tin jar can bottle printed_box wooden_box basket book book_stack tape tea_packet lunch_tin "
        "gift_box plate bowl mug tumbler paper_roll hat torch cable carton spray_bottle flask saucepan "
        "camera teacups"
    ),
    "bedside": (
        "lamp clock book book_stack tumbler mug tissue_box spectacles phone watch jewellery_box candle "
        "frame teddy perfume tube_paste vase_flowers cable remote_control hairbrush bell keys"
    ),
    "washing": (
        "soap_dispenser toothbrush_cup soap tube_paste spray_bottle perfume hairbrush napkin tea_towel "
        "paper_roll tumbler bottle jar tissue_box pot_plant succulent candle basket crumpled_cloth"
    ),
    "floor": (
        "ball toy_blocks toy_car teddy shoe cushion basket crumpled_cloth pot_plant book_stack magazine "
        "newspaper wooden_box gift_box hat wool lantern speaker cable paper_roll headphones flask"
    ),
}

_ALL = sorted({family for families in _FAMILIES.values() for family in families.split()})
ZONES: dict[str, tuple[str, ...]] = {
    family: tuple(zone for zone, families in _FAMILIES.items() if family in families.split())
    for family in _ALL
}
"""The zones in which each family of props is at home: `cooking`, `dining`, `drinks`, `desk`, `reading`,
`display`, `storage`, `bedside`, `washing`, `floor`."""
