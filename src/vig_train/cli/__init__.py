"""The verbs of classes and networks: name, settings, and `module:function` that does the work."""

from vig_train.cli.settings import Build, Calibrate, CheckClass, Evaluate, Train, TrainClass

VERBS = (
    ("train", Train, "vig_train.cli.train:train"),
    ("class build", Build, "vig_train.cli.classes:build"),
    ("class train", TrainClass, "vig_train.cli.class_train:train_class"),
    ("class check", CheckClass, "vig_train.cli.class_check:check_class"),
    ("calibrate", Calibrate, "vig_train.cli.calibrate:calibrate"),
    ("evaluate", Evaluate, "vig_train.cli.evaluate:evaluate"),
)
