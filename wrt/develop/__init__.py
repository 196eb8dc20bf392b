"""Developing: from radiance to a picture for people, by exposure and tone curve."""
