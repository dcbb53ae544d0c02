"""What can be concealed: each effect acts on the stages of the plant, and does nothing at strength 0."""
