"""Puts this folder on the import path, so that tests share fleet.py."""

import torch

torch.set_num_threads(1)
